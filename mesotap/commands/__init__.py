"""What the commands of `mesotap` do, apart from the words on their command line."""
