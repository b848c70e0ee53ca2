"""The process on the robot: sources of measurements, the estimators, sinks of estimates; see docs/on-board.md.

    source -> messages -> estimators -> states of the robot -> sinks

Sources and sinks run beside each other, end and begin again on their own; the estimators are in one place, have no
clock, no files and no threads, and see messages in the order of their own time.
"""
