"""What a person looks at: the Rerun log and its layout, the report, the live view."""
