"""Registration of a rigid model to a cloud without a starting guess: Super4PCS."""
