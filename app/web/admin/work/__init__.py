"""What lies on the server and is done with it: uploaded files, strokes for masks, queued jobs."""
