"""How functions are compiled: quickly, in few programs, kept between runs."""
