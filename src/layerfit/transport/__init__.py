"""Solvers: from the columns of a stack to responses in spatial frequency, and from those to what a measurement sees."""
