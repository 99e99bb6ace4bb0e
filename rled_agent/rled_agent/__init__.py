"""Learners, behaviours and the safety gate of robot learning from expert demonstrations."""
