"""What the site needs beside Sphinx: copies of the pages, formulas, links of terms, checks."""
