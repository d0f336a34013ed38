"""The output-error fit: model, likelihood of time records and frequency responses, Levenberg-Marquardt."""
