"""Running cases: one, many, refined; every study goes through ``run_case``."""
