"""Experiments on one feather or strip."""
