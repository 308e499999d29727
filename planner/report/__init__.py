"""Tables, figures and the page; nothing is computed here."""
