"""Write the report: its page, sections, tables, figures and charts."""
