"""Takes watches and instances of inotify and epoll until it gets no more; a host that gives no
watches at all is fine."""
import ctypes
import os
import select

import hostile

libc = ctypes.CDLL(None, use_errno=True)


def attack(_player):
    instances = []
    while len(instances) < 1000:
        fd = libc.inotify_init1(0)
        if fd < 0:
            break
        instances.append(fd)
    watches = 0
    for folder, folders, _ in os.walk("/usr/share") if instances else ():
        for name in folders:
            path = os.path.join(folder, name).encode()
            watches += libc.inotify_add_watch(instances[0], path, 0xFFF) >= 0
        if watches > 20000:
            break
    pollers = []
    try:
        while len(pollers) < 1000:
            pollers.append(select.epoll())
    except OSError:
        pass
    bounded = len(instances) < 1000 and watches < 30000 and len(pollers) < 1000
    hostile.report("watches", "bounded" if bounded else "without end")
    for fd in instances:
        os.close(fd)


hostile.play(attack)
