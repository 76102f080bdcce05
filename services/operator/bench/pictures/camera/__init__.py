"""The cameras of the pictures: lenses, how two of them stand, and the sensor."""
