"""Rigs of one to four bodies with something concealed in them, and recordings of them, for a blind validation.

It shares no code with what it judges: every law is written anew from its description and the literature.
"""
