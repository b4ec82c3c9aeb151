"""What is read from trials: turning speed, lines, levels, courses in time, noise."""
