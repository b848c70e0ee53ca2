"""Plots and the self-contained HTML report: building blocks for any subject."""

from ohmward.report.axis import WallClock
from ohmward.report.drawing import Plot
from ohmward.report.figure import TIME, Band, Figure, Marker, Series, Span
from ohmward.report.map import Line, Map
from ohmward.report.page import Page

__all__ = ["TIME", "Band", "Figure", "Line", "Map", "Marker", "Page", "Plot", "Series", "Span", "WallClock"]
