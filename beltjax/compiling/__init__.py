"""Compiling: functions compile quickly, in few programs, which are kept between runs."""
