"""Figures of batteries, drives and ranges; `ohmward.report` draws them."""
