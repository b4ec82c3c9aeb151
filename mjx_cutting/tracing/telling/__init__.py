"""What is made of a finding: the verdict, what remains and goes with what, which trial would tell more."""
