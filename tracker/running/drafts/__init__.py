"""Drafts of configurations, for a folder of recordings with its footage, plates and rig.

For `init`; imports readers of rigs and footage.
"""
