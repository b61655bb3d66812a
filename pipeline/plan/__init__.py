"""Which effects a frame calls for, at which level, and why."""

from pipeline.plan.make import SKIPPED, Effect, Plan, Step, make_plan

__all__ = ["SKIPPED", "Effect", "Plan", "Step", "make_plan"]
