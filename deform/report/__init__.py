"""The output folder of a survey in, documents for people out: page, PDF, workbook, GIS; no science here."""

from deform.report.screening import write_screening as write_screening
from deform.report.write import write_report as write_report
