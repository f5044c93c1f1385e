"""Never says hello and keeps a processor busy."""
while True:
    pass
