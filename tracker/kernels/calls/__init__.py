"""Calls of the kernels with arguments without data, of the types that the package uses: what is compiled ahead."""

from __future__ import annotations

from typing import Any

Call = tuple[Any, tuple[Any, ...]]
"""A kernel and its arguments."""
