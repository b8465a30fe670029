"""What families of label maps share: reading PNGs, sums of integers, intervals, verification."""
