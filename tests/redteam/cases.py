"""The table of cases 1 to 46: hostile programs and the verdict that each must get. 47 and 48 are
rejected at submission, see submissions.py; more.py goes on from 49.

An argument in braces is filled in by the suite: {tcp}, {unix}, {abstract} are sockets of the host,
{store}, {artefacts}, {sim}, {source}, {canary} paths of it.
"""

from table import (ABSENT, LACKING_MEMORY_GROUP, LACKING_TASK_GROUP, SCORED, UNREACHABLE, Case,
                   Variant, each)

SLEEPER = ("wall_timeout", "step_timeout")

TIME = (
    Case(1, "busy loop before the handshake", "c01_spins_before_hello.py",
         (Variant(expect=("init_timeout",), track="rt-start", limit="startup_s", wall_s=6),), True),
    Case(2, "busy loop in a step", "c02_spins_in_a_step.py",
         (Variant(expect=("step_timeout",), track="rt-spin", steps=3, limit="step_s"),), True),
    Case(3, "sleeps for ever", "c03_sleeps.py",
         each(("sleep", "pause", "select"), expect=SLEEPER, steps=3, limit="wall_factor")
         + (Variant(("naps",), expect=SLEEPER, track="rt-lease", limit="lease_wall_s"),)),
    Case(4, "stops itself", "c04_stops_itself.py",
         (Variant(expect=("step_timeout",), steps=3, limit="wall_factor"),), True),
    Case(5, "ignores every signal", "c05_ignores_signals.py",
         (Variant(expect=("step_timeout",), steps=3, limit="wall_factor", clean_s=0.5),)),
)

PROCESSES = (
    Case(6, "signals to everybody", "c06_signals_everyone.py",
         each([f"{name} {whom}" for name in ("SIGSTOP", "SIGKILL")
               for whom in ("parent", "first", "all", "each")],
              expect=SCORED + ("crash",), track="rt-patient", reports={"survived": "yes"})),
    Case(7, "fork bomb", "c07_fork_bomb.c",
         (Variant(expect=("process_limit",), track="rt-start", limit="tasks",
                  lacking=LACKING_TASK_GROUP),), True),
    Case(8, "daemons left behind", "c08_daemons.py", (Variant(reports={"daemons": "running"}),),
         True),
    Case(9, "exits while 100 children keep busy", "c09_children_keep_busy.c",
         (Variant(expect=("crash",), detail="status 0", cpu_s=0.3),)),
    Case(10, "thread bomb", "c10_thread_bomb.c",
         (Variant(expect=("process_limit",), track="rt-start", limit="tasks",
                  lacking=LACKING_TASK_GROUP),), True),
    Case(11, "zombie farm", "c11_zombie_farm.py",
         (Variant(expect=SCORED + ("process_limit",), track="rt-patient",
                  reports={"zombies": "many"}),)),
    Case(12, "storm of signals and timers", "c12_signal_storm.c",
         (Variant(expect=("init_timeout", "process_limit"), track="rt-start", wall_s=6,
                  lacking=LACKING_TASK_GROUP),)),
)

RESOURCES = (
    Case(13, "heap growth", "c13_heap.c",
         (Variant(expect=("memory_limit",), limit="memory_bytes", lacking=LACKING_MEMORY_GROUP),),
         True),
    Case(14, "512 MiB of static data", "c14_large_bss.c",
         (Variant(expect=("memory_limit", "crash"), lacking=LACKING_MEMORY_GROUP),)),
    Case(15, "deep recursion", "c15_recursion.c",
         each(("plain", "unlimited"), expect=("memory_limit", "crash"))),
    Case(16, "memory that is not a process'", "c16_other_memory.c",
         each(("tmp", "shm", "memfd", "sysv"), expect=("memory_limit",), track="rt-memory",
              limit="memory_bytes", lacking=LACKING_MEMORY_GROUP)
         # The kernel rejects queues long before they could reach the limit.
         + (Variant(("mq",), expect=("crash", "memory_limit"), track="rt-memory",
                    reports={"refused": "EMFILE"}),)),
    Case(17, "huge sparse file", "c17_sparse_file.c",
         each(("mapped", "written"), expect=("memory_limit", "disk_limit"))),
    Case(18, "stdout flood", "c18_stdout_flood.py",
         (Variant(expect=SCORED, track="rt-patient", truncated=("stdout",)),),
         True),
    Case(19, "stderr flood, long lines, NULs, no UTF-8", "c19_stderr_flood.py",
         each(("flood", "lines", "nul", "invalid"), expect=SCORED,
              track="rt-patient", truncated=("stderr",))),
    Case(20, "fills its disk", "c20_fills_disk.py",
         each([f"{way} {folder}" for way in ("bytes", "inodes") for folder in ("/tmp", "/dev/shm")]
              + ["deep /tmp"], expect=("disk_limit",), track="rt-patient", clean_s=1.0)
         + (Variant(("names", "/tmp"), reports={"odd": "made"}, clean_s=1.0),)),
    Case(21, "prints the grader's words", "c21_fake_words.py",
         (Variant(absent=("\x1b", "\x9b", "\x07"), check="clean_text"),), True),
)

BUS = (
    Case(22, "reaches for other networks", "c22_network.c",
         (Variant(("tcp", "{tcp}", "unix", "{unix}", "abstract", "{abstract}"),
                  denied=("internet_tcp", "internet_udp", "link_local", "private", "internet_six",
                          "link_local_six", "host_loopback", "host_unix", "host_abstract",
                          "netlink", "netlink_dgram", "vsock", "packet", "packet_dgram",
                          "raw_icmp", "raw_ip", "raw_six", "bluetooth", "alg", "can", "tipc",
                          "xdp"),
                  denied_with=UNREACHABLE),), True),
    Case(23, "listens to other buses", "c23_listens_everywhere.py",
         (Variant(track="rt-patient", reports={"foreign_packets": "0"}, beside=("other",)),)),
    Case(24, "speaks as the grader", "c24_speaks_as_grader.py",
         each([f"MYOGRADE_{name}" for name in ("OBSERVATION", "WELCOME", "EPISODE_START",
                                               "EPISODE_END")],
              expect=("protocol",), steps=3, detail="only the grader")
         + each(("MYOGRADE_RESULT", "MYOGRADE_RESET", "LCM_SELF_TEST", "x"),
                reports={"sent": "20"})),
    Case(25, "old, double, early and rival answers", "c25_replays.py",
         each(("double", "old-few"), expect=SCORED)
         + each(("old-flood",), expect=("protocol",), limit="stray_messages")
         + each(("give-up-and-act",), expect=SCORED + ("protocol",))
         + each(("future", "far-future", "give-up-future"), expect=("protocol",), steps=5, limit="wrong_answers")
         + each(("two-publishers",), expect=SCORED + ("protocol",))),
    Case(26, "malformed messages", "c26_malformed.py",
         each(("fingerprint", "other-type", "short", "header-only", "empty", "long",
               "negative-size", "smallest-size", "huge-size", "wrapping-size", "empty-string",
               "negative-string", "huge-string", "endless-string", "negative-sets", "huge-sets",
               "cut-sets", "giving-up-short", "giving-up-as-action"),
              expect=("protocol",), steps=3, detail="wrong message")),
    Case(27, "fragments and garbage", "c27_fragments.py",
         each(("offset 200", "half 200", "none 200", "garbage 100"), track="rt-patient")
         + each(("offset 2000", "half 3000", "none 2000", "garbage 2000"),
                expect=("protocol",), limit="stray_messages", track="rt-patient")
         # The program's own liblcm receives the claims too, and may crash on them.
         + each(("claim 200",), expect=SCORED + ("crash",), track="rt-patient")
         + each(("claim 3000",), expect=("protocol", "crash"), track="rt-patient")),
    Case(28, "actions that are no numbers, or odd ones", "c28_odd_numbers.py",
         each(("nan", "infinite", "minus-infinite", "none", "fewer", "more", "many"),
              expect=("protocol",), steps=3)
         + each(("huge", "minus-huge", "denormal"), check="finite")
         + (Variant(("nan",), expect=("protocol",), steps=3, track="rt-arm"),
            Variant(("huge",), track="rt-arm", check="finite"))
         + each(("huge", "minus-huge"), expect=SCORED + ("unstable",), profile="myosuite",
                check="finite")
         + (Variant(("huge",), expect=SCORED + ("unstable",), profile="myosuite", track="rt-arm",
                    check="finite"),)),
    Case(29, "answers unasked, or does not listen", "c29_does_not_listen.py",
         (Variant(("early",), expect=("step_timeout",), limit="wall_factor",
                  reports={"early": "sent"}),
          Variant(("never",), expect=("step_timeout",), steps=3, reports={"sockets": "100"}),
          Variant(("slowly",), expect=("step_timeout",), steps=3,
                  reports={"reading": "slowly"}))),
    # UDP has no connection to lose: a policy that rejoins the bus and answers has done nothing
    # wrong.
    Case(30, "leaves the bus and comes back", "c30_reconnects.py",
         each(("exits", "breaks"), expect=("crash",), steps=4)
         + each(("returns", "greets"), expect=SCORED)
         + each(("greets-often",), expect=("protocol",), limit="stray_messages")),
    Case(31, "dies", "c31_dies.py",
         tuple(Variant((way,), expect=("crash",), detail=words, track=track, steps=3)
               for way, words, track in (
                   ("exit-0", "status 0", "rt"), ("exit-1", "status 1", "rt"),
                   ("exit-255", "status 255", "rt"), ("raises", "status 1", "rt"),
                   ("abort", "SIGABRT", "rt"), ("SIGSEGV", "SIGSEGV", "rt"),
                   ("SIGFPE", "SIGFPE", "rt"), ("SIGKILL", "SIGKILL", "rt"),
                   ("SIGSYS", "SIGSYS", "rt"), ("SIGXCPU", "SIGXCPU", "rt"),
                   ("xcpu-caught", "SIGKILL", "rt-patient"))), True),
)

WALLS = (
    Case(32, "looks for the host in /proc and /sys", "c32_reads_proc.py",
         (Variant(denied=("first_environ", "first_mem", "first_maps", "first_root", "first_cwd",
                          "first_exe", "first_fd", "first_auxv", "first_stack", "first_syscall",
                          "first_smaps", "first_io", "proc_kcore", "proc_kmsg",
                          "proc_sysrq-trigger", "sys_kernel", "sys_class", "sys_fs_cgroup",
                          "dev_mem", "dev_kmsg", "dev_sda", "dev_vda", "run_dbus", "etc_shadow",
                          "proc_1_root_etc_shadow", "etc_hostname", "etc_machine-id", "root",
                          "home", "var_lib", "var_log", "boot", "opt", "srv", "mnt",
                          "write_sysctl", "write_core_pattern"),
                  denied_with=ABSENT, at_most={"processes": 5},
                  reports={"strange_processes": "0", "hostname": "myograde", "cgroup_above": "0",
                           "network_devices": "1"}),), True),
    Case(33, "looks for the grader's files", "c33_reads_secrets.py",
         (Variant(("{store}", "{artefacts}", "{data}", "{sim}", "{source}", "{canary}"),
                  denied=tuple(f"named_{i}" for i in range(6))
                  + tuple(f"guess_{i}" for i in range(8)),
                  denied_with=ABSENT, reports={"myograde": "myograde-bridge"}),), True),
    Case(34, "writes where it must not", "c34_writes_where_not.py",
         (Variant(denied=tuple(f"create_{name}" for name in (
             "policy", "usr", "lib", "bin", "etc", "root", "runtime", "dev", "myograde", "proc"))
                  + tuple(f"{how}_{name}" for how in ("open", "chmod") for name in (
                      "own", "manifest", "python", "passwd", "hosts", "bridge"))
                  + ("unlink_own", "rename_own", "move_policy", "link_out", "touch_own"),
                  denied_with=ABSENT + ("EBUSY", "ETXTBSY")),), True),
    Case(35, "links, pipes and devices where the grader may read", "c35_traps_for_readers.py",
         (Variant(("{canary}",), denied=("device", "character", "hard_link", "hard_link_own",
                                         "canary"),
                  denied_with=ABSENT, reports={"traps": "set"}, check="canary"),)),
    Case(36, "changes itself between episodes", "c36_changes_itself.py",
         (Variant(episodes=2, denied=("overwrite", "replace", "rename_folder"),
                  denied_with=ABSENT + ("EBUSY", "ETXTBSY"), check="same_hash"),)),
    Case(37, "leaked descriptors", "c37_leaked_descriptors.c",
         (Variant(reports={"open_descriptors": "0", "usable_descriptors": "0", "stdin": "empty",
                           "terminal": "no"}),), True),
    Case(38, "system calls that reach beyond", "c38_system_calls.c",
         (Variant(denied=(
             "ptrace_attach", "ptrace_seize", "process_vm_readv", "process_vm_writev",
             "pidfd_getfd", "process_madvise", "kcmp", "move_pages", "bpf", "perf_event_open",
             "userfaultfd", "io_uring_setup", "io_uring_enter", "io_uring_register", "add_key",
             "request_key", "keyctl", "kexec_load", "kexec_file_load", "init_module",
             "finit_module", "delete_module", "syslog", "fanotify_init", "quotactl", "acct",
             "iopl", "ioperm", "swapon", "swapoff", "mount", "umount2", "pivot_root", "chroot",
             "fsopen", "open_tree", "move_mount", "mount_setattr", "name_to_handle_at",
             "open_by_handle_at", "sethostname", "setdomainname", "settimeofday",
             "clock_settime", "clock_adjtime", "vhangup", "reboot", "setns", "unshare_user",
             "unshare_net", "unshare_mount", "clone_user", "clone3", "terminal_input"),
                  denied_with=("EPERM", "ENOSYS")),), True),
    Case(39, "system calls of 32 bits and of x32", "c39_other_calls.c",
         (Variant(denied=("legacy_getpid", "legacy_mkdir", "x32_getpid", "x32_mkdir",
                          "program32", "folder_made"),
                  denied_with=("EPERM", "ENOSYS", "ENOENT", "killed")),), True),
    Case(40, "asks for more rights", "c40_wants_rights.c",
         (Variant(denied=("setuid_0", "setgid_0", "setreuid_0", "setuid_host", "capset",
                          "ambient_raise", "no_new_privs_off", "sudo", "su", "mount",
                          "chmod_setuid_root", "setuid_copy", "seccomp_off"),
                  denied_with=("EPERM", "EINVAL", "EACCES"),
                  reports={"no_new_privs": "1", "effective": "0000000000000000",
                           "permitted": "0000000000000000", "bounding": "0000000000000000",
                           "ambient": "0000000000000000", "seccomp": "2", "copy": "allowed"}),),
         True),
    Case(41, "two that talk to each other", "c41_covert_pair.py",
         (Variant(("listens",), track="rt-patient", beside=("speaks",),
                  reports={f"heard_{way}": "0" for way in (
                      "lock", "name", "segment", "file", "watch", "key", "holder", "hint")}),)),
    Case(42, "one that leaves messages for the next", "c42_leaves_messages.py",
         (Variant(repeat=2, reports={"found_files": "0", "found_segment": "0", "found_queue": "0",
                                     "found_key": "0", "found_hint": "0", "found_time": "0",
                                     "left": "files"}),)),
    Case(43, "wants all processors", "c43_wants_processors.py",
         (Variant(track="rt-patient", denied=("nice", "fifo", "round_robin"),
                  at_most={"busy_tenths": 13}, lacking={"cgroup_cpu": SCORED}),)),
    Case(44, "guesses the seeds", "c44_guesses_seeds.py",
         (Variant(episodes=2, truncated=("stdout",), check="no_seed", track="rt-patient"),)),
    # 80 % and 120 % of a step's limit: 0.2 s and, with the bank of overtime, 0.4 s.
    Case(45, "slow but legal, and slow", "c45_slow_but_legal.py",
         (Variant(("0.16",), track="rt-often", episodes=20),
          Variant(("0.48",), track="rt-often", episodes=20, expect=("step_timeout",), steps=3,
                  limit="step_s"))),
    Case(46, "slow start", "c46_slow_start.py", (Variant(cpu_s=2.4),)),
)

CASES = TIME + PROCESSES + RESOURCES + BUS + WALLS
