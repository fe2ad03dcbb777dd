"""What is done with a kernel: files that other tools read, measures of its quality, deblurring."""
