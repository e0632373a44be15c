"""Campaigns: many commands of mesotap on many inputs, each run once, by whatever runs them, in any order.

A task is one command in an empty folder with copies of its inputs. Its name is the hash of what it is: command, content
of the inputs, source of the program. Its result is a file that is complete or absent, so that a campaign goes on where
it was left, and a task that is done twice does no harm. See docs/campaigns.md.
"""
