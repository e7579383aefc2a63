"""What an artist says: which feathers, where, and what they are."""
