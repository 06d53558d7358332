"""Figures and the HTML report."""

from ffsi.report.html import write_report

__all__ = ["write_report"]
