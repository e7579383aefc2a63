"""Feathers of a coat in motion: they keep their leaves on the skin that moves."""

from __future__ import annotations
