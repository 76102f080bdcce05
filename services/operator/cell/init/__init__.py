"""`crosspih cell init`: the questions that make a cell's file, each answer checked at once."""
