"""Many runs: made in processes, and kept."""
