"""What lines of a whole trial do not hold: effects along the path, in time, beside the spindle's lines."""
