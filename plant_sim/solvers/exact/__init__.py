"""Motion between events in closed form; the events located by proved bounds."""
