"""What to draw: value objects that know nothing of the back end that draws them."""

from __future__ import annotations

from hrclog.analyzers.figures.campaign import CampaignFigures, Further, campaign_figures
from hrclog.analyzers.figures.run import RunFigures, run_figures

__all__ = ["CampaignFigures", "Further", "RunFigures", "campaign_figures", "run_figures"]
