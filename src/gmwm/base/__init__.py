"""What every room uses: errors, remarks, units, text, arrays, files, locks and threads. It knows nothing of
signals."""
