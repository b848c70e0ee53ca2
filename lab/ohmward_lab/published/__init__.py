"""Methods of [T] and [P], kept for comparison: joint filters, the hybrid."""
