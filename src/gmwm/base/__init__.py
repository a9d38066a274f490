"""What every room uses: errors, remarks, units, text, arrays, files, locks and threads; it knows no signals."""
