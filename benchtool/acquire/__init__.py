"""Plans, arming, sweeps, recordings, tare and calibration."""
