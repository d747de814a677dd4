"""Read models as glTF: what a document holds, and the model in it."""
