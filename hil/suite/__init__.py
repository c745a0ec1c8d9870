"""Suites: many scenarios, their page, and the comparison of two suites."""
