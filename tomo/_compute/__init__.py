"""Compiled kernels, threads, sums that do not depend on threads, and memory."""
