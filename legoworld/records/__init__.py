"""What legoworld's files hold, one frozen type for each, and the only way to read and write them.

Modules pass these types, never dicts. A file is decoded and checked in one step (`decode`), and its
type is the format's definition: `formats` makes its JSON Schema.
"""
