"""Formulas: pure functions of arrays, importing nothing else of layerfit."""
