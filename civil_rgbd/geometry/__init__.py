"""Pure functions on arrays: rigid transforms, cameras, poses at any instant.

Nothing here goes through BLAS or a vendor's mathematics library: sums and products are spelt out,
so that every processor computes the same bits.
"""
