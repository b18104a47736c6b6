"""Many runs: planned, made in processes or on a cluster, kept."""
