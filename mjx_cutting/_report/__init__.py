"""What every report of ours shares: one page, one set of colours, numbers with units. Loads nothing heavy."""
