"""Making tracks from the datasets people have; reads ground truth, writes only its public half."""
