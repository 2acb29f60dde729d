"""Where pictures are taken from: candidates, the choice among them, and the certificate of what they show."""
