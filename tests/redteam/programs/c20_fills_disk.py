"""Fills its scratch space in one of several ways."""
import os
import sys

import hostile


def huge_file(folder):
    with open(f"{folder}/huge", "wb", buffering=0) as file:
        while True:
            file.write(b"\1" * (1 << 20))


def many_files(folder):
    for i in range(10**6):
        os.close(os.open(f"{folder}/{i}", os.O_CREAT | os.O_WRONLY))


def deep_folders(folder):
    os.chdir(folder)
    for _ in range(10**6):
        os.mkdir("d")
        os.chdir("d")


def odd_names(folder):
    """File names that a careless clean-up trips over; a harmless number of them."""
    for name in (b"...", b".. ", b"-rf *", b"new\nline", b"\x1b[2J", b"\xff\xfe", b"a" * 255):
        os.mkdir(os.path.join(folder.encode(), name))
    deep = os.open(folder, os.O_RDONLY)
    for _ in range(300):
        os.mkdir("d" * 200, dir_fd=deep)
        below = os.open("d" * 200, os.O_RDONLY, dir_fd=deep)
        os.close(deep)
        deep = below
    os.chmod(folder + "/-rf *", 0)
    hostile.report("odd", "made")


WAYS = {"bytes": huge_file, "inodes": many_files, "deep": deep_folders, "names": odd_names}
hostile.play(lambda _player: WAYS[sys.argv[1]](sys.argv[2]))
