"""Plots and the self-contained HTML report: building blocks that know no domain."""

from ohmward.report.figure import TIME, Band, Figure, Marker, Series, Span
from ohmward.report.page import Page

__all__ = ["TIME", "Band", "Figure", "Marker", "Page", "Series", "Span"]
