"""The process on the robot: sources of measurements, the estimators, sinks of estimates; see docs/on-board.md.

    source -> messages -> estimators -> states of the robot -> sinks

Sources and sinks run concurrently and end and restart independently; the estimators are in one place, have no clock,
files or threads, and receive messages in the order of their time stamps.
"""
