"""What only developers run: mutation, generated pages, pictures, reaction times, warm-up."""
