"""The response of a camera: from the values of a file to the light on its sensor."""
