"""Learning from executed cycles: iterative learning control on the model of the joint."""
