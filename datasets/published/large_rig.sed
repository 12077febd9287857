s/0\.225/0.06/
s/^pwm_st(op|art)_us = .*/pwm_st\1_us = 1.0/
s/^pwm_max_us = .*/pwm_max_us = 1000.0/
s/^speed_per_us.*/speed_per_us_rad_s = 1.0/
s/^voltage_nominal_V.*/voltage_nominal_V = 4.2/
s/^radius_m.*/radius_m = { value = 0.033, source = "assumed" }/
s/^mass_kg.*/mass_kg = { value = 0.067, source = "the authors" }/
