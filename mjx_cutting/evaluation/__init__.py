"""What a policy is worth: rollouts by domain, the paper's measures, statistics and figures."""
