"""The page in the browser; the only async code.

The server sends commands and shows events. What turns motors runs in a process of its own
(`bench_process`).
"""
