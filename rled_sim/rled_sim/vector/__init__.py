"""Many environments as one: their states are the rows of arrays, in numpy or in torch.

Whatever concerns one environment has the environment as its leading dimension; ``which`` is a mask, shape (N,).
"""
