"""What an operator does with studies: create, edit, attach, invite, close."""
