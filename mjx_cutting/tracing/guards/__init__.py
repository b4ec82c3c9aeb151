"""What else may be behind a gain that an effect brings: each file a reason to refuse its name."""
