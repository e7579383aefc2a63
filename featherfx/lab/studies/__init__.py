"""One study per thing of the literature, and the page of all of them."""
