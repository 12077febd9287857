"""Browser interface, the only async code. The separate `bench_process` drives the motors."""
