"""Making tracks from datasets: reads ground truth, writes only its public half."""
