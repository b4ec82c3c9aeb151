"""A force model fitted to the lines of all trials, and its error on those held out."""
