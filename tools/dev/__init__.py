"""Tools for developers: mutation, generated pages, pictures, reaction times, warm-up."""
