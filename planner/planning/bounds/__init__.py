"""Lower bounds on the error of any requests, for joints and for a foot."""
