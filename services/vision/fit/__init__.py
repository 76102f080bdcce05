"""The fine fit of the rim in both pictures, from a start within a pixel or two."""
