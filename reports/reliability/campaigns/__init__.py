"""Random campaigns, measured on the bench and damaged as real ones are, given to the commands that read campaigns."""

from reports.reliability.campaigns.attempt import attempt_campaign

__all__ = ["attempt_campaign"]
