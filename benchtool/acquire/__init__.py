"""Plan, arm, sweep, record, tare and calibrate."""
