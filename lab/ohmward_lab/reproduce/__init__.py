"""Tables and figures of [T] and [P] made again: printed numbers beside those of the methods here, and the errata."""
