"""The fine fit of the rim in both pictures, from a start to within a pixel or two."""
