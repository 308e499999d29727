"""Lower bounds on the error of any requests for one joint."""
