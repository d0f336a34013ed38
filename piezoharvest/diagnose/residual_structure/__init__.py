"""What residuals show that is more than noise: tests, regression on signals, noise of the drive."""
