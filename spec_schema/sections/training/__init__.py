"""The training section: stages, optimizers, schedules."""
