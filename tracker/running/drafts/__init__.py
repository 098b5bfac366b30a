"""Drafts of configurations, from what lies in a folder of recordings: its footage, plates and rig.

For `init`; imports readers of rigs and footage.
"""
