"""Evidence about ffsi (`python -m studies`): published and exact values, costs, the paper's study."""
