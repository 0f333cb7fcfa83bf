"""Sections of the page: each has a function `section(diagnosis, asked)`, and its template beside it."""
