"""Tables and figures of [T] and [P] reproduced: printed numbers beside those of the methods here, and the errata."""
