"""Traces: what each process knew at each of its ticks, as fixed records, and their reading back."""
