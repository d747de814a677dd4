"""The engine, the tables, their migrations, keys, and the tasks that the server does."""
