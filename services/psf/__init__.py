"""One person's eye as light, `entoptic psf`: subject → profile (tables), picture, plots, sheets, film → results."""
