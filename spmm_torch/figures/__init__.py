def main(arguments=None):
    return 0
