"""What a person looks at: figures, tables, the HTML report, files."""
