"""How vision does on pictures: it is asked, beside a plain recipe, and judged by the truth."""
