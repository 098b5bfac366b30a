"""Spoilt files against every reader: nothing but one clear line may come of them."""
